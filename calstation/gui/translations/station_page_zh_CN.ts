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
</TS>
