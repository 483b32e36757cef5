<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>AddressEdit</name>
    <message>
        <source>name or IP address</source>
        <translation>主机名或 IP 地址</translation>
    </message>
    <message>
        <source>host</source>
        <translation>主机</translation>
    </message>
    <message>
        <source>port number</source>
        <translation>端口号</translation>
    </message>
</context>
<context>
    <name>LinkSection</name>
    <message>
        <source>Port</source>
        <translation>端口</translation>
    </message>
    <message>
        <source>Address and port number</source>
        <translation>地址和端口号</translation>
    </message>
    <message>
        <source>Modbus unit number</source>
        <translation>Modbus 从站号</translation>
    </message>
    <message>
        <source>Baud</source>
        <translation>波特率</translation>
    </message>
    <message>
        <source>Data bits</source>
        <translation>数据位</translation>
    </message>
    <message>
        <source>Parity</source>
        <translation>校验位</translation>
    </message>
    <message>
        <source>Stop bits</source>
        <translation>停止位</translation>
    </message>
    <message>
        <source>Connected by</source>
        <translation>连接方式</translation>
    </message>
    <message>
        <source>Serial settings</source>
        <translation>串口设置</translation>
    </message>
    <message>
        <source>Link to the table</source>
        <translation>转台连接</translation>
    </message>
    <message>
        <source>Link to the IMU</source>
        <translation>IMU 连接</translation>
    </message>
    <message>
        <source>Look for ports again</source>
        <extracomment>Common port numbers of Modbus TCP and of a serial server. The last address typed for each kind of connection.</extracomment>
        <translation>重新查找端口</translation>
    </message>
    <message>
        <source>network (TCP)</source>
        <translation>网络（TCP）</translation>
    </message>
    <message>
        <source>network: Modbus TCP</source>
        <translation>网络：Modbus TCP</translation>
    </message>
    <message>
        <source>serial line: Modbus RTU</source>
        <translation>串口：Modbus RTU</translation>
    </message>
    <message>
        <source>serial server: Modbus RTU</source>
        <translation>串口服务器：Modbus RTU</translation>
    </message>
    <message>
        <source>serial line</source>
        <translation>串口</translation>
    </message>
    <message>
        <source>Response timeout</source>
        <translation>应答超时</translation>
    </message>
    <message>
        <source>As in the profile.</source>
        <translation>按配置文件。</translation>
    </message>
    <message>
        <source>As in the table profile.</source>
        <translation>按转台配置文件。</translation>
    </message>
    <message>
        <source>The rig is turned by hand: it needs no link and there is nothing to set here.</source>
        <translation>工装由手转动：不需要连接，这里没有要设置的内容。</translation>
    </message>
    <message>
        <source>This station is the virtual bench: a table and a unit in software that speak the protocols of the hardware. It opens its own ports, so there is nothing to set here.

To connect hardware, press “New from copy” above and copy the station “example_hardware”.</source>
        <translation>本工位是虚拟台：转台和产品都由软件模拟，通信协议与真实设备相同。端口由虚拟台自行打开，这里无需设置。

要连接真实设备，请点上方的“复制新建”，复制工位“example_hardware”。</translation>
    </message>
    <message>
        <source>This port is not present now.</source>
        <translation>当前未找到此端口。</translation>
    </message>
    <message>
        <source>serial server (TCP)</source>
        <translation>串口服务器（TCP）</translation>
    </message>
    <message>
        <source>this station&apos;s own</source>
        <translation>本工位单独设置</translation>
    </message>
    <message>
        <source>the profile&apos;s</source>
        <translation>按配置文件</translation>
    </message>
    <message>
        <source>none</source>
        <translation>无</translation>
    </message>
    <message>
        <source>even</source>
        <translation>偶校验</translation>
    </message>
    <message>
        <source>odd</source>
        <translation>奇校验</translation>
    </message>
    <message>
        <source>mark</source>
        <translation>标记（1）</translation>
    </message>
    <message>
        <source>space</source>
        <translation>空格（0）</translation>
    </message>
</context>
<context>
    <name>NewFileBar</name>
    <message>
        <source>New station, file name</source>
        <translation>新建工位，文件名</translation>
    </message>
    <message>
        <source>New product, file name</source>
        <translation>新建产品，文件名</translation>
    </message>
    <message>
        <source>New IMU profile, file name</source>
        <translation>新建 IMU 配置，文件名</translation>
    </message>
    <message>
        <source>New table profile, file name</source>
        <translation>新建转台配置，文件名</translation>
    </message>
    <message>
        <source>copied from</source>
        <translation>复制自</translation>
    </message>
    <message>
        <source>Create</source>
        <translation>新建</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>This name is taken; choose another.</source>
        <translation>此名称已被占用，请换一个。</translation>
    </message>
    <message>
        <source>Only letters a to z, digits, - and _; a letter or digit first.</source>
        <translation>只能用英文字母、数字、- 和 _，且以字母或数字开头。</translation>
    </message>
    <message>
        <source>Type a name first.</source>
        <translation>请先输入名称。</translation>
    </message>
</context>
<context>
    <name>PersonalSection</name>
    <message>
        <source>light</source>
        <translation>浅色</translation>
    </message>
    <message>
        <source>dark</source>
        <translation>深色</translation>
    </message>
    <message>
        <source>Language</source>
        <translation>语言</translation>
    </message>
    <message>
        <source>Colours</source>
        <translation>界面颜色</translation>
    </message>
    <message>
        <source>Engineer&apos;s name in versions</source>
        <translation>版本记录中的工程师姓名</translation>
    </message>
    <message>
        <source>Folder of the runs</source>
        <translation>标定记录文件夹</translation>
    </message>
    <message>
        <source>Required for everything that changes results. Stored only as a salted hash.</source>
        <translation>凡影响标定结果的设置都要此密码。仅保存加盐散列值。</translation>
    </message>
    <message>
        <source>New PIN</source>
        <translation>新密码</translation>
    </message>
    <message>
        <source>The same again</source>
        <translation>再次输入</translation>
    </message>
    <message>
        <source>Set the PIN</source>
        <translation>设置密码</translation>
    </message>
    <message>
        <source>This computer</source>
        <translation>本机设置</translation>
    </message>
    <message>
        <source>The engineer&apos;s PIN</source>
        <translation>工程师密码</translation>
    </message>
    <message>
        <source>Choose a folder</source>
        <translation>选择文件夹</translation>
    </message>
    <message>
        <source>The current PIN is wrong.</source>
        <translation>当前密码不正确。</translation>
    </message>
    <message>
        <source>Change the PIN</source>
        <translation>修改密码</translation>
    </message>
    <message>
        <source>Current PIN</source>
        <translation>当前密码</translation>
    </message>
    <message>
        <source>Logs and results of new runs go into this folder, and the history looks there.</source>
        <translation>新的记录和结果存入此文件夹，历史页也从这里读取。</translation>
    </message>
    <message>
        <source>The two are not the same.</source>
        <translation>两次输入不一致。</translation>
    </message>
    <message>
        <source>Too short: at least {0} characters.</source>
        <translation>太短：至少 {0} 个字符。</translation>
    </message>
    <message>
        <source>Wait {0:.0f} s.</source>
        <translation>请等待 {0:.0f} 秒。</translation>
    </message>
    <message>
        <source>The PIN has been changed.</source>
        <translation>密码已修改。</translation>
    </message>
</context>
<context>
    <name>PortBox</name>
    <message>
        <source>choose or type a port</source>
        <translation>选择或输入端口</translation>
    </message>
</context>
<context>
    <name>ProfilesSection</name>
    <message>
        <source>Line {0}: {1}</source>
        <translation>第 {0} 行：{1}</translation>
    </message>
    <message>
        <source>New from copy</source>
        <translation>复制新建</translation>
    </message>
    <message>
        <source>Text</source>
        <translation>文本</translation>
    </message>
    <message>
        <source>Compare</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>File</source>
        <translation>文件</translation>
    </message>
    <message>
        <source>Kind of file</source>
        <translation>文件类别</translation>
    </message>
    <message>
        <source>Products</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>IMUs</source>
        <translation>IMU</translation>
    </message>
    <message>
        <source>Tables</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>Stations</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>as saved</source>
        <translation>已保存的文本</translation>
    </message>
    <message>
        <source>version {0}</source>
        <translation>版本 {0}</translation>
    </message>
    <message>
        <source>the present text</source>
        <translation>当前文本</translation>
    </message>
    <message>
        <source>The present text is the same as {0}.</source>
        <translation>当前文本与{0}相同。</translation>
    </message>
    <message>
        <source>came with the program; saving makes this site&apos;s copy</source>
        <translation>随软件提供；保存后成为本站自己的副本</translation>
    </message>
    <message>
        <source>this site&apos;s own</source>
        <translation>本站自己的文件</translation>
    </message>
</context>
<context>
    <name>SiteSection</name>
    <message>
        <source>Azimuth of body +y at home</source>
        <translation>零位时载体 +y 轴的方位角</translation>
    </message>
    <message>
        <source>Gravity</source>
        <translation>重力</translation>
    </message>
    <message>
        <source>Latitude</source>
        <extracomment>Gravity in m/s² shown until the surveyed value is typed: it occurs nowhere, so no run starts with it. The last azimuth and gravity given.</extracomment>
        <translation>纬度</translation>
    </message>
    <message>
        <source>North positive. Wrong by 1°: up to 0.19 °/h of gyro bias, 92 ppm of gravity.</source>
        <translation>北纬为正。每差 1°：陀螺零偏最多差 0.19 °/h，重力差 92 ppm。</translation>
    </message>
    <message>
        <source>Longitude</source>
        <translation>经度</translation>
    </message>
    <message>
        <source>East positive.</source>
        <translation>东经为正。</translation>
    </message>
    <message>
        <source>Height above the ellipsoid</source>
        <translation>椭球高</translation>
    </message>
    <message>
        <source>Wrong by 10 m: 3 ppm of gravity.</source>
        <translation>每差 10 m：重力差 3 ppm。</translation>
    </message>
    <message>
        <source>True gravity usually differs from it by about 50 ppm. An error of gravity enters all three accelerometer scale factors one to one: give a surveyed value where ppm matter. Units whose gyros cannot resolve earth rate are not calibrated without one: nothing else would reveal a wrong latitude.</source>
        <translation>实际重力与之通常相差约 50 ppm。重力的误差会一比一地进入三个加表刻度系数：要求到 ppm 时请填写实测值。陀螺分辨不出地球自转的产品没有实测值就不能标定：否则纬度填错无从发现。</translation>
    </message>
    <message>
        <source>Body +y at home, seen from above.</source>
        <translation>零位时载体 +y 轴的指向（俯视）。</translation>
    </message>
    <message>
        <source>The azimuth is found from the data: levelling and gyrocompassing at the first rest.</source>
        <translation>方位角由数据求出：在首次静止时调平并陀螺寻北。</translation>
    </message>
    <message>
        <source>Latitude and longitude are both 0: probably a mistake.</source>
        <translation>纬度和经度都是 0，多半是误填。</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Normal gravity at this latitude and height (WGS-84)</source>
        <translation>此纬度和高度的正常重力（WGS-84）</translation>
    </message>
    <message>
        <source>{percent:+.2f} % from normal gravity: no run starts with it. All three accelerometer scale factors would be off by {ppm:+.0f} ppm.</source>
        <translation>与正常重力相差 {percent:+.2f} %：用此值不能开始标定。三个加表刻度系数都会偏 {ppm:+.0f} ppm。</translation>
    </message>
    <message>
        <source>So near a pole no azimuth can be found from the data; give it below.</source>
        <translation>离极点太近，无法由数据求方位角，请在下面填写。</translation>
    </message>
    <message>
        <source>Clockwise from true north.</source>
        <translation>自真北顺时针。</translation>
    </message>
    <message>
        <source>given here</source>
        <translation>在此填写</translation>
    </message>
    <message>
        <source>found from the data</source>
        <translation>由数据求出</translation>
    </message>
    <message>
        <source>normal gravity, computed</source>
        <translation>正常重力（计算值）</translation>
    </message>
    <message>
        <source>surveyed, given here</source>
        <translation>实测值（在此填写）</translation>
    </message>
</context>
<context>
    <name>StationPage</name>
    <message>
        <source>Station</source>
        <extracomment>Entries of the station file in each of the first sections. Names of the files saved last, until something is typed again.</extracomment>
        <translation>工位</translation>
    </message>
    <message>
        <source>Save and go on</source>
        <translation>保存并继续</translation>
    </message>
    <message>
        <source>Discard and go on</source>
        <translation>放弃并继续</translation>
    </message>
    <message>
        <source>Stay here</source>
        <translation>留在本页</translation>
    </message>
    <message>
        <source>Unsaved changes</source>
        <translation>有未保存的修改</translation>
    </message>
    <message>
        <source>Not saved</source>
        <translation>未能保存</translation>
    </message>
    <message>
        <source>● Not saved: {0}</source>
        <translation>● 未保存：{0}</translation>
    </message>
    <message>
        <source>✓ Saved: {0}</source>
        <translation>✓ 已保存：{0}</translation>
    </message>
    <message>
        <source>Read only: an engineer unlocks it.</source>
        <translation>只读：修改需工程师解锁。</translation>
    </message>
    <message>
        <source>Correct first, in “{0}”: {1}</source>
        <translation>请先改正“{0}”：{1}</translation>
    </message>
    <message>
        <source>New from copy</source>
        <translation>复制新建</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Discard</source>
        <translation>放弃</translation>
    </message>
    <message>
        <source>A run is going on; changes can be saved when it has ended.</source>
        <translation>正在标定，结束后可保存所作修改。</translation>
    </message>
    <message>
        <source>Link to the table</source>
        <translation>转台连接</translation>
    </message>
    <message>
        <source>Link to the IMU</source>
        <translation>IMU 连接</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>Profiles and products</source>
        <translation>配置与产品</translation>
    </message>
    <message>
        <source>This computer</source>
        <translation>本机设置</translation>
    </message>
    <message>
        <source>Only an engineer may change this: press the padlock at the top right.</source>
        <translation>只有工程师可以修改：请点右上角的锁。</translation>
    </message>
    <message>
        <source>{0} (virtual bench)</source>
        <translation>{0}（虚拟台）</translation>
    </message>
</context>
<context>
    <name>StationSection</name>
    <message>
        <source>Seed of the unit and table</source>
        <translation>产品与转台的随机种子</translation>
    </message>
    <message>
        <source>Speed</source>
        <translation>速度</translation>
    </message>
    <message>
        <source>Multiple of real time; 0 is as fast as this computer can.</source>
        <translation>实时的倍数；0 表示尽本机所能。</translation>
    </message>
    <message>
        <source>Name, as in every result</source>
        <translation>名称（写入每份结果）</translation>
    </message>
    <message>
        <source>Table profile</source>
        <translation>转台配置文件</translation>
    </message>
    <message>
        <source>Hand-over folder</source>
        <translation>结果交付文件夹</translation>
    </message>
    <message>
        <source>Virtual bench</source>
        <translation>虚拟台</translation>
    </message>
    <message>
        <source>Hardware</source>
        <translation>真实设备</translation>
    </message>
    <message>
        <source>Nothing moves by itself: the operator is guided. Test the IMU before the first run.</source>
        <translation>没有会自己动的部件：操作员按提示转动。首次运行前请测试IMU。</translation>
    </message>
    <message>
        <source>A run moves the table. Test both links before the first one.</source>
        <translation>标定时转台会运动。首次标定前请先测试两路连接。</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Its limits are on the page “Table”.</source>
        <translation>其限值见“转台”。</translation>
    </message>
    <message>
        <source>The factory&apos;s system collects results here; empty: a folder beside the runs.</source>
        <translation>工厂系统从这里取结果；留空则放在标定记录旁边。</translation>
    </message>
    <message>
        <source>Another seed gives a unit with other errors.</source>
        <translation>换一个种子就是另一台误差不同的产品。</translation>
    </message>
    <message>
        <source>Choose a folder</source>
        <translation>选择文件夹</translation>
    </message>
    <message>
        <source>Table and unit are software that speaks the protocols of the hardware: a whole calibration runs without either. Nothing moves.

For hardware, press “New from copy” above and copy “example_hardware”.</source>
        <translation>转台和产品都由软件模拟，通信协议与真实设备相同：没有设备也能完成全部标定，设备不会实际运动。

要连接真实设备，请点上方的“复制新建”，复制“example_hardware”。</translation>
    </message>
    <message>
        <source>opened by the bench</source>
        <translation>由虚拟台打开</translation>
    </message>
    <message>
        <source>turned by hand</source>
        <translation>手动转动</translation>
    </message>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>IMU</source>
        <translation>IMU</translation>
    </message>
    <message>
        <source>azimuth from the data</source>
        <translation>方位角由数据求出</translation>
    </message>
    <message>
        <source>azimuth {0}°</source>
        <translation>方位角 {0}°</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Gravity</source>
        <translation>重力</translation>
    </message>
    <message>
        <source>normal</source>
        <translation>正常重力</translation>
    </message>
    <message>
        <source>It came with the program; saving a change makes a copy for this site.</source>
        <translation>随软件提供；保存修改后成为本站自己的副本。</translation>
    </message>
    <message>
        <source>Version {0} of this site&apos;s own file.</source>
        <translation>本站文件的版本 {0}。</translation>
    </message>
    <message>
        <source>This site&apos;s own file, not saved from here yet.</source>
        <translation>本站自己的文件，尚未在此保存过。</translation>
    </message>
    <message>
        <source>SHA-256 {0}, as in every result</source>
        <translation>SHA-256 {0}（写入每份结果）</translation>
    </message>
</context>
<context>
    <name>TableSection</name>
    <message>
        <source>Outer axis in the body, at home</source>
        <translation>外框方向（零位，载体系）</translation>
    </message>
    <message>
        <source>Inner axis in the body, at home</source>
        <translation>内框方向（零位，载体系）</translation>
    </message>
    <message>
        <source>Encoder, sigma</source>
        <translation>编码器，1σ</translation>
    </message>
    <message>
        <source>Mounting of the unit, sigma</source>
        <translation>产品安装，1σ</translation>
    </message>
    <message>
        <source>Azimuth of the site, sigma</source>
        <translation>站址方位角，1σ</translation>
    </message>
    <message>
        <source>Tilt of the base, sigma</source>
        <translation>基座倾斜，1σ</translation>
    </message>
    <message>
        <source>Velocity, sigma</source>
        <translation>速度，1σ</translation>
    </message>
    <message>
        <source>Lever arm from the centre</source>
        <translation>相对回转中心的杆臂</translation>
    </message>
    <message>
        <source>Outer</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>From the table profile “{0}”. Changes hold for every station with this profile.</source>
        <translation>来自转台配置“{0}”。修改对使用它的所有工位生效。</translation>
    </message>
    <message>
        <source>Table</source>
        <extracomment>Heights of a joint&apos;s row and of its bar, and the width of its name, px. Distances that the scale&apos;s marks may have, degrees.</extracomment>
        <translation>转台</translation>
    </message>
    <message>
        <source>Accuracy</source>
        <translation>精度</translation>
    </message>
    <message>
        <source>Outer axis</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner axis</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>Lowest angle</source>
        <translation>最小角度</translation>
    </message>
    <message>
        <source>Highest angle</source>
        <translation>最大角度</translation>
    </message>
    <message>
        <source>Largest rate</source>
        <translation>最大角速度</translation>
    </message>
    <message>
        <source>Largest acceleration</source>
        <translation>最大角加速度</translation>
    </message>
    <message>
        <source>Of the velocity at rest and in known motion; larger on a vibrating floor.</source>
        <translation>静止和已知运动时的速度误差；地面振动大则取大。</translation>
    </message>
    <message>
        <source>Interval of velocity observations</source>
        <translation>速度观测间隔</translation>
    </message>
    <message>
        <source>Latency of a polled angle</source>
        <translation>角度读数的延迟</translation>
    </message>
    <message>
        <source>From the middle between request and answer.</source>
        <translation>自请求与应答的中点算起。</translation>
    </message>
    <message>
        <source>Jitter of the latency, sigma</source>
        <translation>延迟抖动，1σ</translation>
    </message>
    <message>
        <source>found by the calibration</source>
        <translation>由标定求出</translation>
    </message>
    <message>
        <source>none: the unit turns about its centre</source>
        <translation>无：产品绕自身中心转动</translation>
    </message>
</context>
<context>
    <name>TestPanel</name>
    <message>
        <source>Not tested with these settings. The findings of a test are shown here.</source>
        <translation>当前设置尚未测试。测试结果将显示在这里。</translation>
    </message>
    <message>
        <source>Opens the link as typed, saved or not, identifies the device and checks its data. Nothing moves and no calibration is written.</source>
        <translation>按当前填写的设置（无论是否已保存）打开连接，识别设备并检查其数据。设备不会运动，也不写入标定数据。</translation>
    </message>
    <message>
        <source>A run is going on; test when it has ended.</source>
        <translation>正在标定，结束后再测试。</translation>
    </message>
    <message>
        <source>A test is going on.</source>
        <translation>正在测试。</translation>
    </message>
    <message>
        <source>A fault is being reset.</source>
        <translation>正在复位故障。</translation>
    </message>
    <message>
        <source>Correct what is marked first.</source>
        <translation>请先改正标出的项。</translation>
    </message>
    <message>
        <source>Not ready: correct what is marked</source>
        <translation>不可用：请处理标出的项</translation>
    </message>
    <message>
        <source>Connection test</source>
        <translation>连接测试</translation>
    </message>
    <message>
        <source>Expected: the IMU of product</source>
        <extracomment>Findings after which a reset of the table is offered. The settings that were tested.</extracomment>
        <translation>按此产品的 IMU 核对</translation>
    </message>
    <message>
        <source>Test the table</source>
        <translation>测试转台</translation>
    </message>
    <message>
        <source>Test the IMU</source>
        <translation>测试 IMU</translation>
    </message>
    <message>
        <source>The link works</source>
        <translation>连接正常</translation>
    </message>
    <message>
        <source>The link works, but a run would not start like this</source>
        <translation>连接正常，但此状态下不能开始标定</translation>
    </message>
    <message>
        <source>The test could not be made</source>
        <translation>测试未能进行</translation>
    </message>
</context>
<context>
    <name>TravelPicture</name>
    <message>
        <source>no travel: the lowest angle must lie below the highest</source>
        <translation>无行程：最小角度须小于最大角度</translation>
    </message>
    <message>
        <source>{0:g} turns in all</source>
        <translation>共 {0:g} 圈</translation>
    </message>
    <message>
        <source>{0:g}° in all</source>
        <translation>共 {0:g}°</translation>
    </message>
</context>
<context>
    <name>VersionsPanel</name>
    <message>
        <source>Versions</source>
        <translation>版本</translation>
    </message>
    <message>
        <source>None yet. Every change saved here is kept with its time, author and hash.</source>
        <translation>暂无。在此保存的每次修改都会留存，并记录时间、作者和散列值。</translation>
    </message>
    <message>
        <source>Compare</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>Restore</source>
        <translation>恢复</translation>
    </message>
    <message>
        <source>  ·  current</source>
        <translation>  ·  当前</translation>
    </message>
    <message>
        <source>found, not saved here</source>
        <translation>原有文件，非在此保存</translation>
    </message>
    <message>
        <source>Choose a version in the list.</source>
        <translation>请先在列表中选择版本。</translation>
    </message>
    <message>
        <source>Puts its text into the editor; saving makes it a new version.</source>
        <translation>把该版本放回编辑器；保存后成为新版本。</translation>
    </message>
</context>
<context>
    <name>_Confirmation</name>
    <message>
        <source>Confirm: the station is at this site</source>
        <translation>确认：工位就在此处</translation>
    </message>
    <message>
        <source>✓ This site was confirmed on this computer ({0}).</source>
        <translation>✓ 已在本机（{0}）确认站址。</translation>
    </message>
    <message>
        <source>The confirmed site is “{0}”, not this one on this computer ({1}): no run starts. Check latitude, height and gravity, then confirm the site.</source>
        <translation>已确认的是“{0}”，而不是本机（{1}）上的这一站址：标定无法开始。请核实纬度、高度和重力，再确认。</translation>
    </message>
    <message>
        <source>This site has not been confirmed on this computer ({0}). Units whose gyros cannot resolve earth rate are calibrated only at a confirmed site, and a confirmed file is refused on another computer.</source>
        <translation>本机（{0}）上尚未确认站址。陀螺分辨不出地球自转的产品，须先确认站址才能标定；确认过的文件换到别的计算机上会被拒绝。</translation>
    </message>
</context>
<context>
    <name>station_finding</name>
    <message>
        <source>Connected to {host}, port {port}.</source>
        <translation>已连接 {host}，端口 {port}。</translation>
    </message>
    <message>
        <source>Port {port} opened.</source>
        <translation>端口 {port} 已打开。</translation>
    </message>
    <message>
        <source>Port {port} opened, now {device}.</source>
        <translation>端口 {port} 已打开，目前为 {device}。</translation>
    </message>
    <message>
        <source>“{name}” is turned by hand: there is no link to test.</source>
        <translation>“{name}”由手转动：没有要测试的连接。</translation>
    </message>
    <message>
        <source>There is no port {port}.</source>
        <translation>没有端口 {port}。</translation>
    </message>
    <message>
        <source>Plug the adapter in, or choose another port. Found now: {found}.</source>
        <translation>请插上转换器，或另选端口。目前有：{found}。</translation>
    </message>
    <message>
        <source>No USB adapter for {port} is plugged in, or several are.</source>
        <translation>{port} 对应的 USB 转换器未插入，或有多个。</translation>
    </message>
    <message>
        <source>Plug it in, or choose another port. Found now: {found}.</source>
        <translation>请插上，或另选端口。目前有：{found}。</translation>
    </message>
    <message>
        <source>This user may not use port {port}.</source>
        <translation>当前用户无权使用端口 {port}。</translation>
    </message>
    <message>
        <source>Allow it (on Linux: add the user to the group dialout, then log in again).</source>
        <translation>请授权（Linux：把用户加入 dialout 组后重新登录）。</translation>
    </message>
    <message>
        <source>Port {port} is in use.</source>
        <translation>端口 {port} 被占用。</translation>
    </message>
    <message>
        <source>Close the other program that has it open, then test again.</source>
        <translation>请关闭占用它的程序后再测试。</translation>
    </message>
    <message>
        <source>Port {port} refuses {baud} baud, parity {parity}, {stop_bits:g} stop bits.</source>
        <translation>端口 {port} 不支持 {baud} 波特、校验 {parity}、{stop_bits:g} 停止位。</translation>
    </message>
    <message>
        <source>Choose settings that the adapter can do ({words}).</source>
        <translation>请选择转换器支持的参数（{words}）。</translation>
    </message>
    <message>
        <source>“{port}” is no address.</source>
        <translation>“{port}”不是地址。</translation>
    </message>
    <message>
        <source>Give host and port number.</source>
        <translation>请填写主机和端口号。</translation>
    </message>
    <message>
        <source>Nobody knows the host “{host}”.</source>
        <translation>找不到主机“{host}”。</translation>
    </message>
    <message>
        <source>Correct its name, or give its IP address.</source>
        <translation>请改正主机名，或填写 IP 地址。</translation>
    </message>
    <message>
        <source>{host} is there, but serves nothing at port {number}.</source>
        <translation>{host} 在线，但端口 {number} 无服务。</translation>
    </message>
    <message>
        <source>Correct the port number; see that the device&apos;s server is on.</source>
        <translation>请改正端口号，并确认设备的服务已开启。</translation>
    </message>
    <message>
        <source>{host} does not answer within {seconds:g} s.</source>
        <translation>{host} 在 {seconds:g} 秒内无应答。</translation>
    </message>
    <message>
        <source>Check power, network cable and IP address ({words}).</source>
        <translation>请检查电源、网线和 IP 地址（{words}）。</translation>
    </message>
    <message>
        <source>Port {port} cannot be opened.</source>
        <translation>端口 {port} 无法打开。</translation>
    </message>
    <message>
        <source>The system says: {words}.</source>
        <translation>系统提示：{words}。</translation>
    </message>
    <message>
        <source>The link was lost during the test.</source>
        <translation>测试中连接中断。</translation>
    </message>
    <message>
        <source>Check cable and power ({words}).</source>
        <translation>请检查电缆和电源（{words}）。</translation>
    </message>
    <message>
        <source>{model}, serial number {serial}.</source>
        <translation>{model}，序列号 {serial}。</translation>
    </message>
    <message>
        <source>“{found}” answers, the profile is for “{expected}”.</source>
        <translation>应答的是“{found}”，而配置文件对应“{expected}”。</translation>
    </message>
    <message>
        <source>Choose the profile that belongs to the device.</source>
        <translation>请选择与设备相符的配置文件。</translation>
    </message>
    <message>
        <source>Correct the unit number or choose another table profile; then look at the table.</source>
        <translation>请改正从站号或选择其他转台配置，然后检查转台。</translation>
    </message>
    <message>
        <source>The connection stands, but nobody answers as unit {unit}.</source>
        <translation>已连通，但从站 {unit} 无应答。</translation>
    </message>
    <message>
        <source>Correct the unit number; see that Modbus TCP is switched on.</source>
        <translation>请改正从站号，并确认 Modbus TCP 已开启。</translation>
    </message>
    <message>
        <source>Something answers, but not in Modbus TCP.</source>
        <translation>有应答，但不是 Modbus TCP。</translation>
    </message>
    <message>
        <source>Correct the port number: Modbus TCP is usually 502.</source>
        <translation>请改正端口号：Modbus TCP 一般为 502。</translation>
    </message>
    <message>
        <source>Nobody answers as unit {unit} at {baud} baud.</source>
        <translation>{baud} 波特下从站 {unit} 无应答。</translation>
    </message>
    <message>
        <source>Check power, unit number, baud and parity, and whether the two wires are swapped.</source>
        <translation>请检查电源、从站号、波特率和校验位，以及 A、B 两线是否接反。</translation>
    </message>
    <message>
        <source>{count} bytes came, but they are no Modbus answer.</source>
        <translation>收到 {count} 字节，但不是 Modbus 应答。</translation>
    </message>
    <message>
        <source>Baud or parity is wrong (set here: {baud} baud, parity {parity}), or another device is connected there, perhaps the IMU.</source>
        <translation>波特率或校验位不对（当前 {baud} 波特、校验 {parity}），或者这里接的是别的设备，例如 IMU。</translation>
    </message>
    <message>
        <source>Set the baud and parity in the serial server (the profile says {line}); or another device is connected there, perhaps the IMU.</source>
        <translation>请在串口服务器里设置波特率和校验位（配置文件为 {line}）；也可能这里接的是别的设备，例如 IMU。</translation>
    </message>
    <message>
        <source>The serial server is there, but nobody answers as unit {unit}.</source>
        <translation>串口服务器在线，但没有设备以从站号 {unit} 应答。</translation>
    </message>
    <message>
        <source>Check power and unit number, and the baud and parity set in the serial server (the profile says {line}).</source>
        <translation>请检查电源和从站号，以及串口服务器里设置的波特率和校验位（配置文件为 {line}）。</translation>
    </message>
    <message>
        <source>“{model}” answers as unit {found}.</source>
        <translation>“{model}”以从站号 {found} 应答。</translation>
    </message>
    <message>
        <source>Set the unit number to {found} instead of {unit}.</source>
        <translation>请把从站号由 {unit} 改为 {found}。</translation>
    </message>
    <message>
        <source>The table profile is another&apos;s: choose {profile}, unit number {found}.</source>
        <translation>转台配置不是这台设备的：请选择 {profile}，从站号 {found}。</translation>
    </message>
    <message>
        <source>Unit numbers that answer: {units}.</source>
        <translation>有应答的从站号：{units}。</translation>
    </message>
    <message>
        <source>Correct the unit number, or choose another table profile.</source>
        <translation>请改正从站号，或选择其他转台配置。</translation>
    </message>
    <message>
        <source>Frames of “{profile}” come here: this is the IMU&apos;s line.</source>
        <translation>这里收到“{profile}”的数据帧：这是 IMU 的线路。</translation>
    </message>
    <message>
        <source>Exchange the ports of table and IMU.</source>
        <translation>请把转台和 IMU 的端口对调。</translation>
    </message>
    <message>
        <source>The answer&apos;s check (CRC) is wrong: bytes are lost or spoilt.</source>
        <translation>应答的 CRC 校验错误：有字节丢失或受干扰。</translation>
    </message>
    <message>
        <source>Check shielding, grounding and the termination of the line; then the stop bits.</source>
        <translation>请检查屏蔽、接地和终端电阻，再查停止位。</translation>
    </message>
    <message>
        <source>Only the question itself comes back.</source>
        <translation>收到的只是自己发出的询问。</translation>
    </message>
    <message>
        <source>Switch the adapter&apos;s echo off; see that the table is connected and on.</source>
        <translation>请关闭转换器的回显，并确认转台已接好、已上电。</translation>
    </message>
    <message>
        <source>Unit {found} answers instead of unit {unit}.</source>
        <translation>应答的是从站 {found}，而不是 {unit}。</translation>
    </message>
    <message>
        <source>Set the unit number to {found}, or correct it at the table.</source>
        <translation>请把从站号设为 {found}，或在转台上改正。</translation>
    </message>
    <message>
        <source>Nothing answers at {baud} baud within {seconds:g} s.</source>
        <translation>{baud} 波特下 {seconds:g} 秒内无应答。</translation>
    </message>
    <message>
        <source>Check power, cable, baud and parity; the table may be under local control.</source>
        <translation>请检查电源、电缆、波特率和校验位；转台可能处于本地控制。</translation>
    </message>
    <message>
        <source>The connection stands, but nothing answers within {seconds:g} s.</source>
        <translation>已连通，但 {seconds:g} 秒内无应答。</translation>
    </message>
    <message>
        <source>Check the port number, and [text] in the table profile.</source>
        <translation>请检查端口号，以及转台配置的 [text]。</translation>
    </message>
    <message>
        <source>{count} bytes came, but they are no text.</source>
        <translation>收到 {count} 字节，但不是文本。</translation>
    </message>
    <message>
        <source>Set the baud and parity in the serial server, where there is one (the profile says {line}); or another device is connected there, perhaps the IMU.</source>
        <translation>如经串口服务器连接，请在其中设置波特率和校验位（配置文件为 {line}）；也可能这里接的是别的设备，例如 IMU。</translation>
    </message>
    <message>
        <source>Something answers, but not as the profile says: “{said}”.</source>
        <translation>有应答，但与配置不符：“{said}”。</translation>
    </message>
    <message>
        <source>Compare [text] in the table profile with the table&apos;s manual.</source>
        <translation>请对照转台手册核对转台配置的 [text]。</translation>
    </message>
    <message>
        <source>An answer does not look as the profile says.</source>
        <translation>应答的格式与配置不符。</translation>
    </message>
    <message>
        <source>Correct its pattern under [text.queries] ({words}).</source>
        <translation>请改正 [text.queries] 中的格式（{words}）。</translation>
    </message>
    <message>
        <source>A register does not hold what the profile says.</source>
        <translation>寄存器内容与配置文件不符。</translation>
    </message>
    <message>
        <source>Correct its entry under [registers] ({words}).</source>
        <translation>请修正 [registers] 中的对应条目（{words}）。</translation>
    </message>
    <message>
        <source>The table refuses a question ({words}).</source>
        <translation>转台拒绝询问（{words}）。</translation>
    </message>
    <message>
        <source>Correct [text.queries] in the table profile.</source>
        <translation>请改正转台配置的 [text.queries]。</translation>
    </message>
    <message>
        <source>The profile knows no watchdog of it: only moves to angles are made, which end by themselves.</source>
        <translation>配置中没有它的看门狗：只做到位运动，到位即自行停止。</translation>
    </message>
    <message>
        <source>The table refuses to be read: {meaning}.</source>
        <translation>转台拒绝读取：{meaning}。</translation>
    </message>
    <message>
        <source>{count} polls answered: {typical_ms:.1f} ms as a rule, {worst_ms:.1f} ms at worst.</source>
        <translation>{count} 次查询均有应答：一般 {typical_ms:.1f} ms，最慢 {worst_ms:.1f} ms。</translation>
    </message>
    <message>
        <source>More than {limit_ms:.0f} ms counts as lost: look for load on the line.</source>
        <translation>超过 {limit_ms:.0f} ms 按丢失处理：请查线路负载。</translation>
    </message>
    <message>
        <source>Its watchdog stops it after {seconds:g} s without a word.</source>
        <translation>看门狗：{seconds:g} 秒无通信即停车。</translation>
    </message>
    <message>
        <source>Its watchdog is off (0): nothing would stop it if this computer died.</source>
        <translation>看门狗未开启（0）：若本机故障，转台不会自行停车。</translation>
    </message>
    <message>
        <source>Set the watchdog&apos;s time in the drive, 1000 ms for example; no run starts without.</source>
        <translation>请在驱动器中设定看门狗时间，例如 1000 ms；未设定不能标定。</translation>
    </message>
    <message>
        <source>The fault “{fault}” is latched.</source>
        <translation>故障“{fault}”已锁存。</translation>
    </message>
    <message>
        <source>Remove its cause, then press “Reset the fault”.</source>
        <translation>请排除原因，然后按“复位故障”。</translation>
    </message>
    <message>
        <source>A fault is latched, and the table does not tell its cause.</source>
        <translation>有故障锁存，但转台没有说明原因。</translation>
    </message>
    <message>
        <source>Read the table&apos;s display, remove the cause, then press “Reset the fault”.</source>
        <translation>请查看转台的显示，排除原因，然后按“复位故障”。</translation>
    </message>
    <message>
        <source>The table is under local control.</source>
        <translation>转台处于本地控制。</translation>
    </message>
    <message>
        <source>Switch it to remote control at its panel.</source>
        <translation>请在转台面板上切换到远程控制。</translation>
    </message>
    <message>
        <source>The interlock is closed.</source>
        <translation>联锁已闭合。</translation>
    </message>
    <message>
        <source>The interlock is open.</source>
        <translation>联锁断开。</translation>
    </message>
    <message>
        <source>Close the cover before a run.</source>
        <translation>标定前请关好防护罩。</translation>
    </message>
    <message>
        <source>Outer {outer:.3f}°, inner {inner:.3f}°.</source>
        <translation>外框 {outer:.3f}°，内框 {inner:.3f}°。</translation>
    </message>
    <message>
        <source>The table is moving, though nothing here has asked it to.</source>
        <translation>转台正在运动，但并非由本软件发出。</translation>
    </message>
    <message>
        <source>Find out who else commands it before a run.</source>
        <translation>标定前请查明是谁在控制它。</translation>
    </message>
    <message>
        <source>Not homed since power-on; a run homes it first, slowly.</source>
        <translation>上电后尚未回零；标定时会先低速回零。</translation>
    </message>
    <message>
        <source>The {joint} axis says {angle:.1f}°, outside the profile&apos;s {profile_low:g}° to {profile_high:g}°.</source>
        <translation>{joint}轴读数 {angle:.1f}°，超出配置的 {profile_low:g}° 至 {profile_high:g}°。</translation>
    </message>
    <message>
        <source>Correct the register&apos;s scale or address, or the travel, in the table profile.</source>
        <translation>请在转台配置中改正寄存器的比例或地址，或改正行程。</translation>
    </message>
    <message>
        <source>The {joint} axis allows {low:g}° to {high:g}°, the profile {profile_low:g}° to {profile_high:g}°.</source>
        <translation>{joint}轴允许 {low:g}° 至 {high:g}°，配置为 {profile_low:g}° 至 {profile_high:g}°。</translation>
    </message>
    <message>
        <source>Make the profile&apos;s travel no wider than the table&apos;s, or widen the table&apos;s.</source>
        <translation>请使配置的行程不大于转台的行程，或放宽转台的行程。</translation>
    </message>
    <message>
        <source>The {joint} axis allows {low:g}° to {high:g}°, as the profile needs.</source>
        <translation>{joint}轴允许 {low:g}° 至 {high:g}°，满足配置。</translation>
    </message>
    <message>
        <source>Not a byte comes from the unit.</source>
        <translation>没有收到产品的任何字节。</translation>
    </message>
    <message>
        <source>Check power, cable and port; transmit and receive may be swapped.</source>
        <translation>请检查电源、电缆和端口；收发线可能接反。</translation>
    </message>
    <message>
        <source>{bytes} bytes came, but no frame of “{profile}” is among them.</source>
        <translation>收到 {bytes} 字节，但没有“{profile}”的数据帧。</translation>
    </message>
    <message>
        <source>Baud or parity is wrong (set here: {baud} baud, parity {parity}), or the profile is another unit&apos;s.</source>
        <translation>波特率或校验位不对（当前 {baud} 波特、校验 {parity}），或配置文件不是这种产品的。</translation>
    </message>
    <message>
        <source>Set the baud and parity in the serial server (the profile says {line}), or choose the unit&apos;s own profile.</source>
        <translation>请在串口服务器里设置波特率和校验位（配置文件为 {line}），或选用该产品自己的配置文件。</translation>
    </message>
    <message>
        <source>The table answers here: this is its line.</source>
        <translation>这里应答的是转台：这是转台的线路。</translation>
    </message>
    <message>
        <source>At {found} baud the frames are right.</source>
        <translation>在 {found} 波特下数据帧正确。</translation>
    </message>
    <message>
        <source>Set the baud to {found} instead of {baud}.</source>
        <translation>请把波特率由 {baud} 改为 {found}。</translation>
    </message>
    <message>
        <source>Frames begin, but the check of every one ({kind}) is wrong.</source>
        <translation>有帧头，但每帧的校验（{kind}）都不对。</translation>
    </message>
    <message>
        <source>Correct the frame&apos;s fields and check in the IMU profile; then parity and stop bits.</source>
        <translation>请改正 IMU 配置中的字段和校验方式，再查校验位和停止位。</translation>
    </message>
    <message>
        <source>Lines come, but none begins with “{sync}”: “{line}”.</source>
        <translation>收到了文本行，但没有一行以“{sync}”开头：“{line}”。</translation>
    </message>
    <message>
        <source>Correct sync in [frame] of the IMU profile.</source>
        <translation>请改正 IMU 配置 [frame] 中的 sync。</translation>
    </message>
    <message>
        <source>Lines come, but without “{mark}” and a check behind it: “{line}”.</source>
        <translation>收到了文本行，但其中没有“{mark}”及其后的校验值：“{line}”。</translation>
    </message>
    <message>
        <source>Correct mark and crc in [frame] of the IMU profile.</source>
        <translation>请改正 IMU 配置 [frame] 中的 mark 和 crc。</translation>
    </message>
    <message>
        <source>Lines come, but their check is wrong: “{line}” says {told}, {kind} from byte {start} on is {right}.</source>
        <translation>收到了文本行，但校验不符：“{line}”给出 {told}，从第 {start} 字节起按 {kind} 计算应为 {right}。</translation>
    </message>
    <message>
        <source>Correct crc.kind or crc.start in [frame] of the IMU profile.</source>
        <translation>请改正 IMU 配置 [frame] 中的 crc.kind 或 crc.start。</translation>
    </message>
    <message>
        <source>Behind “{sync}” no separator “{separator}” stands: “{line}”.</source>
        <translation>“{sync}”之后不是分隔符“{separator}”：“{line}”。</translation>
    </message>
    <message>
        <source>Correct sync, which ends before the first separator, or separator, in [frame] of the IMU profile.</source>
        <translation>请改正 IMU 配置 [frame] 中的 sync（不含第一个分隔符）或 separator。</translation>
    </message>
    <message>
        <source>Column {column} is “{text}”, no number for {field}: “{line}”.</source>
        <translation>第 {column} 列是“{text}”，不能作为 {field} 的数值：“{line}”。</translation>
    </message>
    <message>
        <source>Correct the fields in [frame] of the IMU profile; columns count from 0 behind the first separator.</source>
        <translation>请改正 IMU 配置 [frame] 中的字段；列号从第一个分隔符之后由 0 数起。</translation>
    </message>
    <message>
        <source>There is no column {column} for {field}; the line has {count}: “{line}”.</source>
        <translation>{field} 所在的第 {column} 列不存在，该行共有 {count} 列：“{line}”。</translation>
    </message>
    <message>
        <source>{frames} frames came, but none with the counter and all six channels.</source>
        <translation>收到 {frames} 帧，但没有一帧同时含有计数器和全部六个通道。</translation>
    </message>
    <message>
        <source>Correct the fields in [frame] of the IMU profile, or what the unit is set to send.</source>
        <translation>请改正 IMU 配置 [frame] 中的字段，或改正产品的输出设置。</translation>
    </message>
    <message>
        <source>{frames} samples came, but no command is answered.</source>
        <translation>收到 {frames} 个样本，但命令无应答。</translation>
    </message>
    <message>
        <source>Check the wire that transmits to the unit; then [commands] in the IMU profile.</source>
        <translation>请检查发往产品的信号线，再查 IMU 配置的 [commands]。</translation>
    </message>
    <message>
        <source>The unit refuses a command ({words}).</source>
        <translation>产品拒绝命令（{words}）。</translation>
    </message>
    <message>
        <source>Correct [commands] in the IMU profile.</source>
        <translation>请改正 IMU 配置的 [commands]。</translation>
    </message>
    <message>
        <source>The unit only streams and cannot say who it is; its number is typed in.</source>
        <translation>产品只输出数据，不能报告身份；序列号由人工输入。</translation>
    </message>
    <message>
        <source>Serial number {serial} does not fit the product&apos;s pattern {pattern}.</source>
        <translation>序列号 {serial} 不符合产品的格式 {pattern}。</translation>
    </message>
    <message>
        <source>Choose the product that belongs to the unit, or correct its pattern.</source>
        <translation>请选择与之相符的产品，或改正格式。</translation>
    </message>
    <message>
        <source>{count} calibration registers read.</source>
        <translation>已读出 {count} 个标定寄存器。</translation>
    </message>
    <message>
        <source>The profile names no calibration registers; nothing will be written.</source>
        <translation>配置文件没有标定寄存器，不会写入。</translation>
    </message>
    <message>
        <source>The calibration registers cannot be read.</source>
        <translation>标定寄存器无法读出。</translation>
    </message>
    <message>
        <source>Correct [[registers]] in the IMU profile ({words}).</source>
        <translation>请改正 IMU 配置的 [[registers]]（{words}）。</translation>
    </message>
    <message>
        <source>{measured:.1f} samples per second, as expected.</source>
        <translation>每秒 {measured:.1f} 个样本，与配置一致。</translation>
    </message>
    <message>
        <source>{measured:.1f} samples per second, the profile says {expected:g}.</source>
        <translation>每秒 {measured:.1f} 个样本，而配置为 {expected:g}。</translation>
    </message>
    <message>
        <source>Set the unit&apos;s rate, or correct sample_rate_hz in the IMU profile.</source>
        <translation>请设定产品的输出频率，或改正 IMU 配置的 sample_rate_hz。</translation>
    </message>
    <message>
        <source>The unit answers, but sends no samples.</source>
        <translation>产品有应答，但没有输出数据。</translation>
    </message>
    <message>
        <source>Switch its output on; check [frame] in the IMU profile.</source>
        <translation>请打开产品的输出，并检查 IMU 配置的 [frame]。</translation>
    </message>
    <message>
        <source>{count} samples without a gap.</source>
        <translation>{count} 个样本，无丢帧。</translation>
    </message>
    <message>
        <source>{gaps} gaps, {missing} samples missing, {errors} frames with a wrong check.</source>
        <translation>{gaps} 处间断，缺 {missing} 个样本，{errors} 帧校验错误。</translation>
    </message>
    <message>
        <source>Check the cable; raise the baud if it is too low for the rate.</source>
        <translation>请检查电缆；若波特率跟不上采样率，请提高。</translation>
    </message>
    <message>
        <source>The unit reports a failed self-test.</source>
        <translation>产品报告自检失败。</translation>
    </message>
    <message>
        <source>Replace the unit, or correct [status] in the IMU profile.</source>
        <translation>请更换产品，或改正 IMU 配置的 [status]。</translation>
    </message>
    <message>
        <source>The unit reports a saturated output.</source>
        <translation>产品报告输出饱和。</translation>
    </message>
    <message>
        <source>Let it stand still and test again.</source>
        <translation>请保持静止后再测试。</translation>
    </message>
    <message>
        <source>The unit is not ready after {seconds:g} s.</source>
        <translation>{seconds:g} 秒后产品仍未就绪。</translation>
    </message>
    <message>
        <source>Wait and test again, or correct [status] in the IMU profile.</source>
        <translation>请稍候再测试，或改正 IMU 配置的 [status]。</translation>
    </message>
    <message>
        <source>Its temperature is {celsius:.1f} °C.</source>
        <translation>温度 {celsius:.1f} °C。</translation>
    </message>
    <message>
        <source>It measures {measured:.3f} m/s², gravity here is {expected:.3f} m/s².</source>
        <translation>测得 {measured:.3f} m/s²，当地重力为 {expected:.3f} m/s²。</translation>
    </message>
    <message>
        <source>The site is still the example&apos;s: {latitude:g}°, {longitude:g}°, {height:g} m.</source>
        <translation>站址仍是示例工位的：{latitude:g}°，{longitude:g}°，{height:g} m。</translation>
    </message>
    <message>
        <source>Put in the site of this station, unless it stands just there.</source>
        <translation>请填写本工位的站址（除非恰好就在那里）。</translation>
    </message>
    <message>
        <source>Nobody has said at this computer ({computer}) that the station stands where its file says.</source>
        <translation>尚无人在本机（{computer}）确认工位就在文件所写的站址。</translation>
    </message>
    <message>
        <source>Make sure of latitude, height and gravity, then confirm the place: in the section Site, or by “{entry}” in site.confirmed_on of the station file.</source>
        <translation>请核实纬度、高度和重力，然后确认工位位置：在“站址”一栏中确认，或在工位文件的 site.confirmed_on 中写入“{entry}”。</translation>
    </message>
    <message>
        <source>Surveyed gravity is missing, and these gyros do not feel the earth turn: a wrong latitude would show nowhere.</source>
        <translation>缺少实测重力，而这些陀螺感受不到地球自转：纬度填错将无从发现。</translation>
    </message>
    <message>
        <source>Give site.gravity_mps2 as surveyed at the place, from a gravity net or a gravimeter.</source>
        <translation>请在 site.gravity_mps2 中填写当地实测重力（取自重力网或重力仪）。</translation>
    </message>
    <message>
        <source>site.gravity_mps2 = {gravity:g} does not belong to latitude {latitude:g}° and height {height:g} m, where normal gravity is {normal:.5f} m/s².</source>
        <translation>site.gravity_mps2 = {gravity:g} 与纬度 {latitude:g}°、高度 {height:g} m 不符，该处正常重力为 {normal:.5f} m/s²。</translation>
    </message>
    <message>
        <source>Correct gravity, latitude or height.</source>
        <translation>请改正重力、纬度或高度。</translation>
    </message>
    <message>
        <source>“{rig}” is turned by hand, but stages of “{product}” need a table that is driven.</source>
        <translation>“{rig}”靠手转动，而“{product}”的阶段需要电动转台。</translation>
    </message>
    <message>
        <source>Choose a product that is carried by hand (manual = true), or another station.</source>
        <translation>请选择靠手转动的产品（manual = true），或换一个工位。</translation>
    </message>
    <message>
        <source>“{rig}” is driven, but stages of “{product}” are carried by hand (manual = true).</source>
        <translation>“{rig}”是电动转台，而“{product}”的阶段要靠手转动（manual = true）。</translation>
    </message>
    <message>
        <source>Choose another product, or a station with rails turned by hand.</source>
        <translation>请选择其他产品，或换用导轨靠手转动的工位。</translation>
    </message>
    <message>
        <source>Looked at as a unit of “{product}”, by the profile “{profile}”.</source>
        <translation>按产品“{product}”、配置“{profile}”检查。</translation>
    </message>
    <message>
        <source>If it stands still: correct accel_lsb, output or the frame&apos;s fields in the IMU profile, or choose another product.</source>
        <translation>若产品静止：请改正IMU 配置的 accel_lsb、output 或帧字段，或选择其他产品。</translation>
    </message>
    <message>
        <source>it does not know holding registers</source>
        <translation>不支持保持寄存器</translation>
    </message>
    <message>
        <source>See in its manual how its registers are read.</source>
        <translation>请查转台手册中读取寄存器的方法。</translation>
    </message>
    <message>
        <source>no such register</source>
        <translation>没有该寄存器</translation>
    </message>
    <message>
        <source>Correct the addresses in the table profile; they count from 0.</source>
        <translation>请改正转台配置中的地址（从 0 开始）。</translation>
    </message>
    <message>
        <source>the device cannot do it now, or is not unit {unit}</source>
        <translation>设备当前不能执行，或从站号不是 {unit}</translation>
    </message>
    <message>
        <source>it is busy</source>
        <translation>设备忙</translation>
    </message>
    <message>
        <source>Wait and test again.</source>
        <translation>请稍候再测试。</translation>
    </message>
    <message>
        <source>the gateway knows no way to unit {unit}</source>
        <translation>网关没有通往从站 {unit} 的路径</translation>
    </message>
    <message>
        <source>Correct the unit number, or the gateway&apos;s table.</source>
        <translation>请改正从站号或网关的路由表。</translation>
    </message>
    <message>
        <source>behind the gateway nobody answers as unit {unit}</source>
        <translation>网关之后的从站 {unit} 无应答</translation>
    </message>
    <message>
        <source>Correct the unit number; check the line behind the gateway.</source>
        <translation>请改正从站号，并检查网关之后的线路。</translation>
    </message>
    <message>
        <source>Modbus exception {code}</source>
        <translation>Modbus 异常码 {code}</translation>
    </message>
    <message>
        <source>See the table&apos;s manual.</source>
        <translation>请查转台手册。</translation>
    </message>
    <message>
        <source>outer</source>
        <translation>外</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内</translation>
    </message>
    <message>
        <source>Starting the virtual bench.</source>
        <translation>正在启动虚拟台。</translation>
    </message>
    <message>
        <source>Opening the port.</source>
        <translation>正在打开端口。</translation>
    </message>
    <message>
        <source>Asking.</source>
        <translation>正在询问。</translation>
    </message>
    <message>
        <source>Listening to the stream.</source>
        <translation>正在监听数据流。</translation>
    </message>
    <message>
        <source>Listening at other bauds.</source>
        <translation>正在试听其他波特率。</translation>
    </message>
    <message>
        <source>Asking other unit numbers.</source>
        <translation>正在询问其他从站号。</translation>
    </message>
    <message>
        <source>Looking whether the two ports are exchanged.</source>
        <translation>正在检查两个端口是否接反。</translation>
    </message>
    <message>
        <source>nothing</source>
        <extracomment>Findings whose mend is another one behind a serial server, which has the baud in settings of its own. What is told beside what is wrong, with a mend of its own. Every finding&apos;s sentence and mend.</extracomment>
        <translation>无</translation>
    </message>
</context>
</TS>
